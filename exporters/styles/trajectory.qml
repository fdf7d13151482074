<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Colour: quality of the GNSS fix. Shape: circle forward, triangle in reverse (pointing where the vehicle points), square standing. -->
<qgis version="3.34.0" styleCategories="Symbology|MapTips|Temporal">
 <temporal enabled="1" mode="1" startField="time" endField="" startExpression="" endExpression="" durationField="" durationUnit="ms" fixedDuration="100" limitMode="0" accumulate="0">
  <fixedRange>
   <start></start>
   <end></end>
  </fixedRange>
 </temporal>
 <renderer-v2 type="categorizedSymbol" attr="fix" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <categories>
   <category value="fixed" type="string" symbol="0" label="RTK fixed" render="true"/>
   <category value="float" type="string" symbol="1" label="RTK float" render="true"/>
   <category value="ppp" type="string" symbol="5" label="PPP" render="true"/>
   <category value="dgps" type="string" symbol="2" label="differential" render="true"/>
   <category value="single" type="string" symbol="3" label="single" render="true"/>
   <category value="none" type="string" symbol="6" label="no position" render="true"/>
   <category value="" type="string" symbol="4" label="other, or from a file" render="true"/>
  </categories>
  <symbols>
   <symbol type="marker" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="26,152,80,255"/>
      <Option name="name" type="QString" value="circle"/>
      <Option name="outline_style" type="QString" value="no"/>
      <Option name="size" type="QString" value="0.7"/>
      <Option name="size_unit" type="QString" value="MM"/>
     </Option>
     <data_defined_properties>
      <Option type="Map">
       <Option name="name" type="QString" value=""/>
       <Option name="properties" type="Map">
        <Option name="angle" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="field" type="QString" value="heading_deg"/>
         <Option name="type" type="int" value="2"/>
        </Option>
        <Option name="name" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="CASE WHEN &quot;motion&quot; = 'reverse' THEN 'triangle' WHEN &quot;motion&quot; = 'standing' THEN 'square' ELSE 'circle' END"/>
         <Option name="type" type="int" value="3"/>
        </Option>
        <Option name="size" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="if(@map_start_time is null, 0.7, 3)"/>
         <Option name="type" type="int" value="3"/>
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection"/>
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
   <symbol type="marker" name="1" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="244,165,40,255"/>
      <Option name="name" type="QString" value="circle"/>
      <Option name="outline_style" type="QString" value="no"/>
      <Option name="size" type="QString" value="0.7"/>
      <Option name="size_unit" type="QString" value="MM"/>
     </Option>
     <data_defined_properties>
      <Option type="Map">
       <Option name="name" type="QString" value=""/>
       <Option name="properties" type="Map">
        <Option name="angle" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="field" type="QString" value="heading_deg"/>
         <Option name="type" type="int" value="2"/>
        </Option>
        <Option name="name" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="CASE WHEN &quot;motion&quot; = 'reverse' THEN 'triangle' WHEN &quot;motion&quot; = 'standing' THEN 'square' ELSE 'circle' END"/>
         <Option name="type" type="int" value="3"/>
        </Option>
        <Option name="size" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="if(@map_start_time is null, 0.7, 3)"/>
         <Option name="type" type="int" value="3"/>
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection"/>
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
   <symbol type="marker" name="2" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="214,96,77,255"/>
      <Option name="name" type="QString" value="circle"/>
      <Option name="outline_style" type="QString" value="no"/>
      <Option name="size" type="QString" value="0.7"/>
      <Option name="size_unit" type="QString" value="MM"/>
     </Option>
     <data_defined_properties>
      <Option type="Map">
       <Option name="name" type="QString" value=""/>
       <Option name="properties" type="Map">
        <Option name="angle" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="field" type="QString" value="heading_deg"/>
         <Option name="type" type="int" value="2"/>
        </Option>
        <Option name="name" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="CASE WHEN &quot;motion&quot; = 'reverse' THEN 'triangle' WHEN &quot;motion&quot; = 'standing' THEN 'square' ELSE 'circle' END"/>
         <Option name="type" type="int" value="3"/>
        </Option>
        <Option name="size" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="if(@map_start_time is null, 0.7, 3)"/>
         <Option name="type" type="int" value="3"/>
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection"/>
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
   <symbol type="marker" name="3" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="178,24,43,255"/>
      <Option name="name" type="QString" value="circle"/>
      <Option name="outline_style" type="QString" value="no"/>
      <Option name="size" type="QString" value="0.7"/>
      <Option name="size_unit" type="QString" value="MM"/>
     </Option>
     <data_defined_properties>
      <Option type="Map">
       <Option name="name" type="QString" value=""/>
       <Option name="properties" type="Map">
        <Option name="angle" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="field" type="QString" value="heading_deg"/>
         <Option name="type" type="int" value="2"/>
        </Option>
        <Option name="name" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="CASE WHEN &quot;motion&quot; = 'reverse' THEN 'triangle' WHEN &quot;motion&quot; = 'standing' THEN 'square' ELSE 'circle' END"/>
         <Option name="type" type="int" value="3"/>
        </Option>
        <Option name="size" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="if(@map_start_time is null, 0.7, 3)"/>
         <Option name="type" type="int" value="3"/>
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection"/>
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
   <symbol type="marker" name="4" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="136,136,136,255"/>
      <Option name="name" type="QString" value="circle"/>
      <Option name="outline_style" type="QString" value="no"/>
      <Option name="size" type="QString" value="0.7"/>
      <Option name="size_unit" type="QString" value="MM"/>
     </Option>
     <data_defined_properties>
      <Option type="Map">
       <Option name="name" type="QString" value=""/>
       <Option name="properties" type="Map">
        <Option name="angle" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="field" type="QString" value="heading_deg"/>
         <Option name="type" type="int" value="2"/>
        </Option>
        <Option name="name" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="CASE WHEN &quot;motion&quot; = 'reverse' THEN 'triangle' WHEN &quot;motion&quot; = 'standing' THEN 'square' ELSE 'circle' END"/>
         <Option name="type" type="int" value="3"/>
        </Option>
        <Option name="size" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="if(@map_start_time is null, 0.7, 3)"/>
         <Option name="type" type="int" value="3"/>
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection"/>
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
   <symbol type="marker" name="5" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="69,117,180,255"/>
      <Option name="name" type="QString" value="circle"/>
      <Option name="outline_style" type="QString" value="no"/>
      <Option name="size" type="QString" value="0.7"/>
      <Option name="size_unit" type="QString" value="MM"/>
     </Option>
     <data_defined_properties>
      <Option type="Map">
       <Option name="name" type="QString" value=""/>
       <Option name="properties" type="Map">
        <Option name="angle" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="field" type="QString" value="heading_deg"/>
         <Option name="type" type="int" value="2"/>
        </Option>
        <Option name="name" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="CASE WHEN &quot;motion&quot; = 'reverse' THEN 'triangle' WHEN &quot;motion&quot; = 'standing' THEN 'square' ELSE 'circle' END"/>
         <Option name="type" type="int" value="3"/>
        </Option>
        <Option name="size" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="if(@map_start_time is null, 0.7, 3)"/>
         <Option name="type" type="int" value="3"/>
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection"/>
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
   <symbol type="marker" name="6" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="34,34,34,255"/>
      <Option name="name" type="QString" value="circle"/>
      <Option name="outline_style" type="QString" value="no"/>
      <Option name="size" type="QString" value="0.7"/>
      <Option name="size_unit" type="QString" value="MM"/>
     </Option>
     <data_defined_properties>
      <Option type="Map">
       <Option name="name" type="QString" value=""/>
       <Option name="properties" type="Map">
        <Option name="angle" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="field" type="QString" value="heading_deg"/>
         <Option name="type" type="int" value="2"/>
        </Option>
        <Option name="name" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="CASE WHEN &quot;motion&quot; = 'reverse' THEN 'triangle' WHEN &quot;motion&quot; = 'standing' THEN 'square' ELSE 'circle' END"/>
         <Option name="type" type="int" value="3"/>
        </Option>
        <Option name="size" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="if(@map_start_time is null, 0.7, 3)"/>
         <Option name="type" type="int" value="3"/>
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection"/>
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <mapTip enabled="1">&lt;b&gt;scan [% "scan" %]&lt;/b&gt;, [% format_date("time", 'HH:mm:ss.zzz') %] UTC&lt;br&gt;[% "motion" %], [% format_number(3.6 * "speed_mps", 1) %] km/h, heading [% round("heading_deg", 1) %]°&lt;br&gt;[% coalesce("fix", 'from a file') %]</mapTip>
</qgis>
