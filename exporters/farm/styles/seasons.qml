<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Ground worked in a season, the darker the more often. -->
<qgis version="3.34.0" styleCategories="Symbology|Labeling|MapTips" labelsEnabled="1">
 <renderer-v2 type="singleSymbol" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <symbols>
   <symbol type="fill" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="173,221,142,190"/>
      <Option name="style" type="QString" value="solid"/>
      <Option name="outline_color" type="QString" value="60,90,60,255"/>
      <Option name="outline_style" type="QString" value="solid"/>
      <Option name="outline_width" type="QString" value="0.2"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
     <data_defined_properties>
      <Option type="Map">
       <Option name="name" type="QString" value=""/>
       <Option name="properties" type="Map">
        <Option name="fillColor" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="ramp_color('YlGn', least(1, &quot;times_worked&quot; / 8.0))"/>
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
 <labeling type="simple">
  <settings calloutType="simple">
   <text-style fieldName="&quot;season&quot; || ': ' || &quot;times_worked&quot; || ' ×'" isExpression="1" fontSize="10" fontSizeUnit="Point" fontFamily="Sans" textColor="30,30,30,255">
    <text-buffer bufferDraw="1" bufferSize="1" bufferSizeUnits="MM" bufferColor="255,255,255,220"/>
   </text-style>
  </settings>
 </labeling>
 <mapTip enabled="1">&lt;b&gt;[% &quot;name&quot; %]&lt;/b&gt;, season [% &quot;season&quot; %]: worked [% &quot;times_worked&quot; %] times&lt;br&gt;[% coalesce(format_number(&quot;worked_area_m2&quot;, 0), '?') %] m² worked, [% coalesce(format_number(&quot;overlap_area_m2&quot;, 0), '?') %] m² twice, [% coalesce(format_number(&quot;missed_area_m2&quot;, 0), '?') %] m² missed&lt;br&gt;[% coalesce(format_number(&quot;hours&quot;, 1), '?') %] h, [% coalesce(format_number(&quot;work_rate_ha_h&quot;, 2), '?') %] ha/h, [% coalesce(format_number(&quot;soil_moved_m3&quot;, 1), '?') %] m³ moved</mapTip>
</qgis>
