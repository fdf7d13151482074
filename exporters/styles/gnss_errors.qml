<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Colour: horizontal error, from 1 cm (blue) over 10 cm and 1 m to 10 m (red), in steps of powers of ten. -->
<qgis version="3.34.0" styleCategories="Symbology|MapTips">
 <renderer-v2 type="graduatedSymbol" attr="error_2d_m" graduatedMethod="GraduatedColor" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <ranges>
   <range lower="0" upper="0.02" symbol="0" label="2D error below 2 cm" render="true"/>
   <range lower="0.02" upper="0.1" symbol="1" label="2 to 10 cm" render="true"/>
   <range lower="0.1" upper="0.5" symbol="2" label="10 to 50 cm" render="true"/>
   <range lower="0.5" upper="2" symbol="3" label="0.5 to 2 m" render="true"/>
   <range lower="2" upper="1e12" symbol="4" label="above 2 m" render="true"/>
  </ranges>
  <symbols>
   <symbol type="marker" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="69,117,180,255"/>
      <Option name="name" type="QString" value="circle"/>
      <Option name="outline_style" type="QString" value="no"/>
      <Option name="size" type="QString" value="1.4"/>
      <Option name="size_unit" type="QString" value="MM"/>
     </Option>
    </layer>
   </symbol>
   <symbol type="marker" name="1" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="145,191,219,255"/>
      <Option name="name" type="QString" value="circle"/>
      <Option name="outline_style" type="QString" value="no"/>
      <Option name="size" type="QString" value="1.4"/>
      <Option name="size_unit" type="QString" value="MM"/>
     </Option>
    </layer>
   </symbol>
   <symbol type="marker" name="2" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="254,224,144,255"/>
      <Option name="name" type="QString" value="circle"/>
      <Option name="outline_style" type="QString" value="no"/>
      <Option name="size" type="QString" value="1.4"/>
      <Option name="size_unit" type="QString" value="MM"/>
     </Option>
    </layer>
   </symbol>
   <symbol type="marker" name="3" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="252,141,89,255"/>
      <Option name="name" type="QString" value="circle"/>
      <Option name="outline_style" type="QString" value="no"/>
      <Option name="size" type="QString" value="1.4"/>
      <Option name="size_unit" type="QString" value="MM"/>
     </Option>
    </layer>
   </symbol>
   <symbol type="marker" name="4" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="215,48,39,255"/>
      <Option name="name" type="QString" value="circle"/>
      <Option name="outline_style" type="QString" value="no"/>
      <Option name="size" type="QString" value="1.4"/>
      <Option name="size_unit" type="QString" value="MM"/>
     </Option>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <mapTip enabled="1">&lt;b&gt;[% "service" %]&lt;/b&gt; ([% "fix" %])&lt;br&gt;[% format_date("time", 'yyyy-MM-dd HH:mm:ss') %] UTC&lt;br&gt;X [% format_number("x_m", 3) %] m, Y [% format_number("y_m", 3) %] m, Z [% coalesce(format_number("z_m", 3), '–') %] m</mapTip>
</qgis>
